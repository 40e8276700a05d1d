"""Scale and speed of a finished drive: corrections of its drift, smoothing of its steps. Tracks and poses are in the folder above."""
