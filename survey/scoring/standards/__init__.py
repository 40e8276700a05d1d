"""Map accuracy standards (ASPRS, NSSDA): editions, formulas, checkpoints and assessments.

Errors without a standard stand in `survey.scoring`.
"""
