"""Proof of a guarantee by simulated surveys of ground that is not drawn from the belief."""
