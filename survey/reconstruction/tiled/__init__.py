"""Maps of surveys that do not fit the memory: points sorted to tiles, strip errors, relief tile by tile.

Begin with `survey_map`, the stages; `job` checks the request, `cells` and `summaries` reduce the points, `strips` and
`global_parameters` solve for what all tiles share, and `fine_relief` and `tile_map` map each tile.
"""
