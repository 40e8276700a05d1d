"""Commands of surveys while they are driven."""
