"""One file for each command of ``firnline``: its options, and the call that carries it out.

What several commands share is in `firnline.cli`; the modes of ``plan`` and ``reconstruct`` have folders of their own.
"""
