"""Actions of firnline: one function for each capability, which reads, checks, computes and returns a result."""
