"""Spatial mechanisms without natural coordinates, for the tests to compare with: NumPy, rotations and closed forms.

Every function takes hardpoints by name (its defaults stand in a dictionary of its name in capitals) and inputs, and
returns points, axes and angles by name, each a `jets.Jet`: position, velocity and acceleration. An input given as a
jet moves by that jet; `phi` of the linkages and shafts given as an array moves at `rate` and `acceleration`.

| module | what it holds |
|---|---|
| `jets` | values with two exact time derivatives, vectors, rotations |
| `closure` | a cos ψ + b sin ψ = c; Newton's method continued from the drawn pose; gradients by hardpoints |
| `shafts` | Cardan joints, bevel gears, steering column |
| `linkages` | RSCR, RSSR, RSSP, RCCC |
| `loops` | spherical four-bar, Bennett, Bricard |
| `platforms` | Stewart–Gough platform, delta robot |
| `suspensions`, `wheel` | double wishbone, MacPherson; wheel angles and offsets |
| `chains` | any loop of R, P, C and S joints, in joint variables |
"""
