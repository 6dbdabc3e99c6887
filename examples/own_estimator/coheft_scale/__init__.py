"""An estimator and a motion for coheft: the robots as one kitchen scale."""
