"""Commands for what a survey carries beside its terrain sensors."""
