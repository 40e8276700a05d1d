"""Plan of the desk: its document, its history, and what is computed from it."""
