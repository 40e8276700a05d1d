"""Test of a guarantee by simulated surveys of ground from other distributions than the posterior."""
