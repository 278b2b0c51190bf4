"""
Motion under random forcing: of the amplitude, and what becomes of it.

`amplitude_noise` gives drift and diffusion of the amplitude, `escape` and `sweep` what follows
from them, `forced_response` and `disturbance` what the roller and a bump do.
"""
