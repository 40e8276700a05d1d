"""Where a rover can drive: traversability and shortest paths on free ground.

Which lines it should drive is decided in `planners.swaths`.
"""
