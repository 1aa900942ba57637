"""Digital twins: a simulated station that follows a running robot.

See `drake_srg.robot.twin.run.run_twin`.
"""
