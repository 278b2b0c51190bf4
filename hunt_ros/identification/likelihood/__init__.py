"""
How likely the measured envelopes are under a growth law, and the law that is likeliest.

`path` (the envelopes in a row), then `amplitude_step` and `path_likelihood` (compiled), then
`trajectory_fit`, which begins where `integral_fit` ends.
"""
