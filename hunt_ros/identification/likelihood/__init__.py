"""
How likely the measured envelopes are under a growth law, and the law that is likeliest.

`path_likelihood` (compiled), `trajectory_fit`, then `spreads`.
"""
