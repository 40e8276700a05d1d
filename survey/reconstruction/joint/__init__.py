"""Map and path as one estimate, with the satellite's cells as measurements; begin with `joint_map`."""
