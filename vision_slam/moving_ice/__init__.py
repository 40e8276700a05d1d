"""Localization on moving ice."""
