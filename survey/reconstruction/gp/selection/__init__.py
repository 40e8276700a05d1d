"""Kernel selection and hyperparameters by marginal likelihood.

The kernels themselves live in `survey.reconstruction.gp.covariance`.
"""
