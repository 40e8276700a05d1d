"""Honesty of maps of missions in images: coverage and error on sites that nothing was chosen on."""
