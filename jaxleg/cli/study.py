"""CONFIG, the study that every command but `replay` begins with, and its robot."""

from typing import Any

from jaxleg.cli.start import configure_jax

NO_CONFIG = "CONFIG is missing; give a TOML file such as configs/quickstart.toml"


def read_study(source: str, overrides: list[str], prog: str) -> tuple[Any, Any, Any]:
    """The study of a config file with its overrides, its robot's file and its robot; JAX is configured on the way.

    Raises `InputError` for what cannot be used, of the study and the robot together.
    """
    from jaxleg.robot import RobotFile, build_robot, check_robot
    from jaxleg.search.checks import check_study
    from jaxleg.search.config import Study, robot_path
    from jaxleg.settings import from_command_line, load

    study = from_command_line(Study, load(Study, source), overrides, prog=prog)
    path = robot_path(study, source)
    file = load(RobotFile, path)
    configure_jax()  # before any array is made, the robot's included
    check_robot(file, str(path))
    robot = build_robot(file)
    check_study(study, source, leg_numbers(robot))
    return study, file, robot


def leg_numbers(robot: Any) -> Any:
    """Lengths of the robot's legs, for the check of the study."""
    from jaxleg.gait.limits import leg_length
    from jaxleg.search.checks import Legs

    return Legs(float(leg_length(robot)), float(-robot.link_offset[0, 1, 2]), float(robot.foot_radius))
