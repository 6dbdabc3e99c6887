"""Equations of Fan et al. (CDC 2017): dual quaternions, recursive least squares, angular acceleration."""
