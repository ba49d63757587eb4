"""The robot: a pytree of all its numbers, from a TOML file that is checked, and as MJCF."""

from jaxleg.robot.check import check_robot, load_robot
from jaxleg.robot.file import Geometry, Masses, Motor, RobotFile, build_robot
from jaxleg.robot.model import Robot

__all__ = ["Geometry", "Masses", "Motor", "Robot", "RobotFile", "build_robot", "check_robot", "load_robot"]
