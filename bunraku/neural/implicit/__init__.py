"""The paper's own form of pose transfer: a shape code, implicit parts, offsets point by point.

After Wang et al. 2023 ([ZPT]), Eqs. 1 to 6. A row of `bunraku evaluate pose`; the route itself
takes the structured form of `bunraku.neural`.

    shape.py      auto-decoded shape code; occupancy, part and inverse MLPs     [ZPT 3.1, Eqs. 1-3]
    poses.py      what poses are learnt from; a pose code in 32 dimensions      [ZPT 3.2]
    offsets.py    offsets of points for a shape code and a pose code            [ZPT 3.2, Eq. 4]
    adapting.py   test-time training: volume, edges, source                     [ZPT 3.3, Eqs. 5-6]
    corpus.py     bodies with parts, figures at rest with occupancy alone       [ZPT 4.1]
    training.py   one course: poses, then shapes, then offsets                  [ZPT 4.2]
    form.py       all of it, applied to an avatar and a figure
"""
