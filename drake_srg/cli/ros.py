"""Arguments of commands that speak ROS."""

from __future__ import annotations

import argparse


def add_ros_arguments(
    command: argparse.ArgumentParser, ros1: str, ros2: str, peer: str
) -> None:
    """Add what a command needs to speak ROS.

    Args:
        command: The command.
        ros1: Help of `--ros1`.
        ros2: Help of `--ros2`.
        peer: For whom this machine's address is.
    """
    command.add_argument("--ros1", action="store_true", help=ros1)
    command.add_argument(
        "--master", metavar="URI", help="ROS 1 master (default: $ROS_MASTER_URI)"
    )
    command.add_argument("--ros2", action="store_true", help=ros2)
    command.add_argument(
        "--domain", type=int, metavar="N", help="ROS 2 domain (default: $ROS_DOMAIN_ID)"
    )
    command.add_argument(
        "--host",
        default="127.0.0.1",
        metavar="ADDRESS",
        help=f"this machine's address for {peer} (default: %(default)s)",
    )


def speaks_ros(options: argparse.Namespace) -> tuple[bool, bool]:
    """Return whether a command is to speak ROS 1, and ROS 2."""
    return (
        options.ros1 or options.master is not None,
        options.ros2 or options.domain is not None,
    )
