"""Simulated rover behind MAVSDK's servers, in a process of its own."""
