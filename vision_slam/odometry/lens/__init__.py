"""Self-calibration of the lens over the tracks of a drive: bundle adjustment, and the judgement of its result.

Camera models live in `survey.data.camera`.
"""
