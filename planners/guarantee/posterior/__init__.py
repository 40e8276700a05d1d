"""Posterior of the terrain's covariance, given the cells of a prior or samples, and the class of surface."""
