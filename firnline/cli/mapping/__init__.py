"""Inputs, outputs and modes of ``firnline reconstruct``: points in one table, or scans one by one.

The reconstruction methods are in `survey.reconstruction`; here are only options, checks and written files.
"""
