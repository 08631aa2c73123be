"""From raw columns to the series that an estimator may trust."""
