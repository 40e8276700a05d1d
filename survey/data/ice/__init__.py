"""Motion of a glacier as data of a survey, and its file."""
