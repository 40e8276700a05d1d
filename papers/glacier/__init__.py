"""Figures and tables of the glacier-survey paper.

Studies shared by several papers live one folder up.
"""
