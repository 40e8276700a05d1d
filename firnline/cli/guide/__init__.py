"""Commands that explain: examples to copy, and help on formats, exit codes and commands."""
