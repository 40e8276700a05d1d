"""Map accuracy standards (ASPRS, NSSDA): editions, formulas, checkpoints and assessments.

Errors without a standard live one folder up.
"""
