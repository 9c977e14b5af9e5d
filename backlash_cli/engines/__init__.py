"""engines: how the loops of a plant are spread over processors"""
