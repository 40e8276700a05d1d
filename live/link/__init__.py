"""MAVLink connections to vehicles."""
