"""commands: the command line, one module per question; what they work with is imported when they run"""
