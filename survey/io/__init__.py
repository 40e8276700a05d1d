"""Read and write files, one module for each family of formats; independent of the survey's data types."""
