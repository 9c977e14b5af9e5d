"""commands: the command line, one module per question, imported when one of its commands runs"""
