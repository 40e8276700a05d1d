"""The command line: the program in `main`, what its commands share, and a folder of commands.

Heavy imports are inside the commands, so that ``--help`` starts fast.
"""
