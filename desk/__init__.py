"""Planning desk: a page on the user's own machine to draw a survey and see its predicted error."""
