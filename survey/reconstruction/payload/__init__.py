"""Maps of quantities that a science payload measured on the way; begin with `payload_map`."""
