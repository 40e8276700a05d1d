"""Faults of the wheels as images show them: slip, and encoders that count nothing. Travel by wheels is in the folder above."""
