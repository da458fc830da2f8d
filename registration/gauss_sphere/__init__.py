"""Registration by planes and their Gauss spheres; `pipeline` is its outline.

In the order of the method, each package knowing only those before it:

fan         a scan as the fan of beams that measured it, its noise, what to leave out
planes      segments of profiles, patches grown from them, planes fitted to their points
candidates  rotations from pairs of normals, shifts that many planes agree on
refinement  poses by the planes they lay on each other, as likely and as sure as these make them
outlines    where faces end, and what a view says of ends that the other one saw
judging     whether the best pose is an answer: rivals, symmetries, open directions, bias

`describing` makes a `view` of a scan, which all after it compare; `params` holds every parameter,
`evidence` what figures draw, `failures` the words where there is no pose. `ranges` says which
parameters loops can run with, `small_matrices` is algebra that they call.
"""
