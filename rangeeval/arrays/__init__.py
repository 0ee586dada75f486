"""Array processing: sensor positions and snapshots in, bearings with their errors out.

The convention of bearings, the same everywhere in this room: radians, in the array's own frame.

- Planar and three-dimensional arrays: atan2(y, x) of the direction *towards* the source, at the fixed elevation
  `ArrayGeometry.elevation_rad` above the x-y plane.
- Line arrays: from broadside, positive towards the line's positive end, so that the phase grows with sin(bearing).
  A line along y has the same bearings as a planar array, folded into -pi/2 .. pi/2.

The sign of the phase: `a_m = exp(+j 2 pi f p_m . u / c)`, a sensor nearer to the source is ahead. A recorder with the
other sign holds conjugated snapshots.

Snapshots are complex: (snapshots, sensors) in narrow band, (snapshots, bins, sensors) in broad band. Rates are
per snapshot. `docs/explanation/bearing.md` has the method.
"""
