"""draft"""


def write_page(states):
    """Draft."""
