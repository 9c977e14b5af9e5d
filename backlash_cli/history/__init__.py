"""Night after night: one SQLite file, the wear of every loop, and the order of repair."""
