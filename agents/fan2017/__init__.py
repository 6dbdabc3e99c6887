"""The method of Fan et al. (CDC 2017) for one robot: recursive least squares of poses and load, dynamic consensus."""
