"""Figures and tables of the three papers: one study each, listed in `studies`, run by ``firnline reproduce``."""
