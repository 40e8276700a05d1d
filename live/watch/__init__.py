"""Map, class and next swath while measurements arrive."""
