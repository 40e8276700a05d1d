"""Honesty of maps: coverage and error of statistical surveys over kinds of terrain and kinds of priors."""
