"""Benchmark of promises on windows of real ground, of stopped surveys, of monotony and of complete glaciers."""
