"""Colour tables of the map: the perceptually uniform ones of the figures, as colours between which is interpolated.

They are stated here because importing the figures takes longer than starting the server.
"""

import numpy as np
import numpy.typing as npt

Table = npt.NDArray[np.uint8]


def _table(colours: str) -> Table:
    """Return 256 colours (256, 3) between those that are named as hexadecimal numbers."""
    named = np.array([list(bytes.fromhex(colour)) for colour in colours.split()], dtype=np.float64)
    places, share = np.linspace(0.0, 1.0, len(named)), np.linspace(0.0, 1.0, 256)
    table = np.stack([np.interp(share, places, channel) for channel in named.T], axis=1)
    return table.round().astype(np.uint8)


ELEVATION = _table(
    "47739d 517b9c 5a829a 638897 6c8e93 75948f 7f9a8b 8aa288 95aa87 a3b489 b4c190 c7d09c d9dfad e7eabe f2f2d0 f8f8e1 fcfcf0"
)
"""Ice: from low to high ground."""
DEVIATION = _table(
    "fffecb fdf2a8 f8e07f f4cd61 efb956 eba853 e89852 e58851 e17750 dc674e d0554c b94a48 9e4442 813c37 67342a 512d1e 3f2615"
)
"""Standard deviations: from certain to uncertain."""
SLOPE = _table(
    "fffecb fcef9f f7d971 f1c159 ecac54 e99a52 e58751 e1744f d85f4d c44e4a a44544 833d38 653329 4b2b1b 362411 261e08 191900"
)
"""From level to steep ground."""
ERROR = _table(
    "001261 022b71 034481 0c5e92 307da6 619ebd 94bed2 c6dbe6 ece5e0 e9cab8 dbaa8d cf8c66 c27041 b2511d 912d06 731406 590008"
)
"""From too low to too high, about zero."""
SUPPORT = _table("5b2a86 d8b365 9ecae1 2b8cbe")
"""Unseen, interpolated, bounded by a line of sight, measured."""


def colour_of(table: Table, share: npt.NDArray[np.float64]) -> Table:
    """Return the colours of shares; those beyond 0 and 1 have the colours of the ends.

    `table` (256, 3): one of the tables of this module.

    >>> bool((colour_of(SLOPE, np.array([0.0, 7.0])) == SLOPE[[0, 255]]).all())
    True
    """
    return table[np.clip(share * 255.0, 0, 255).astype(np.uint8)]


def legend_colours(table: Table, n: int = 8) -> list[str]:
    """Return equally spaced colours of a table for a legend, such as ``#0b3d5c``."""
    rows = table[np.linspace(0, 255, n).astype(int)].tolist()
    return [f"#{red:02x}{green:02x}{blue:02x}" for red, green, blue in rows]
