"""Digital twins: a simulated station that follows a running robot.

See `drake_srg.twin.run.run_twin`.
"""
