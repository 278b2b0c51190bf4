"""
The report: figures and numbers of a run as a paper would print them, in one HTML file.

The only room beside the dashboard that draws. It computes nothing of its own: what it
shows is an `Identification`, the analysis of the records, and the detector's events. `compose`
puts it together: `figures`, and `words` and `tables`, on a `page`.
"""
