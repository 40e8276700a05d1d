"""Checks of the installation and the machine, as ``firnline doctor`` prints them."""
