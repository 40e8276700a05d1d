"""Localization from what a rover senses; it sees a recording, never a world."""
