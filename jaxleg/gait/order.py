"""The order in which the legs swing: the crawl of both planners. Paper A, II.A; C, 3."""

from jaxleg.conventions import LEGS

SHIFT = -1

# Six phases: the body shifts, then the hind and the front leg of one side swing (paper A: RH, RF, LH, LF).
SWING_LEG = (SHIFT, LEGS.index("RH"), LEGS.index("RF"), SHIFT, LEGS.index("LH"), LEGS.index("LF"))
PHASES = len(SWING_LEG)
STEP_LEGS = tuple(leg for leg in SWING_LEG if leg != SHIFT)  # the swinging leg of each step: RH, RF, LH, LF
