"""
Who does the work of an identification, and what of it is remembered.

`places` says where it is done, `kept` that what was worked out of a recording is not worked out
again.
"""
