"""Localization of recorded drives of a real camera, clean and with faults."""
