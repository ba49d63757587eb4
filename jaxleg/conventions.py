"""The one place for orders, frames and signs. Everything else imports them from here.

- Frames: x forward, y left, z up; world frame W, trunk frame B (its origin midway between the four hip joints).
- Legs in the order LF, RF, LH, RH; joints hip (roll), thigh (pitch), knee (pitch).
- Joint angles (paper A, eq. 2): zero is the leg hanging straight down. Positive hip is abduction (foot outwards and
  up, mirrored on the left); positive thigh and knee swing the foot forward, so pitch is positive about -y.
- `f` is the force of the ground on the foot, in W; the motors hold it with tau = -J^T f.
- Quaternions w, x, y, z; SI units; angles in radians (config files may say degrees in the key's name).
- Axis names in shape annotations: leg = 4, joint = 3, xyz = 3, heading = 8, t = time samples, nx, ny = map cells.
"""

LEGS = ("LF", "RF", "LH", "RH")
JOINTS = ("hip", "thigh", "knee")
LEFT_LEGS = (0, 2)
RIGHT_LEGS = (1, 3)
LEG_SIDE = (1.0, -1.0, 1.0, -1.0)  # +1 left, -1 right
LEG_END = (1.0, 1.0, -1.0, -1.0)  # +1 front, -1 hind
RING = (0, 1, 3, 2)  # the feet in order round the support polygon
GRAVITY = 9.81
# Headings of travel over a map: the step in cells (along x, along y) of heading k, which points k * 45 deg to the left of x.
HEADINGS = ((1, 0), (1, 1), (0, 1), (-1, 1), (-1, 0), (-1, -1), (0, -1), (1, -1))


class InputError(ValueError):
    """What a user wrote cannot be used. The message is one sentence; the CLI prints it and exits with status 2."""
