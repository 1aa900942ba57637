"""The SRG grasps a can in MuJoCo, lifts it and holds it.

First write the models: drake-srg export gripper_bench --mjcf -o models
"""

import sys

import mujoco

# How long each step takes [s], the height of the palm over the table at its end [m],
# and the PWM of the wires' motor.
SCRIPT = ((1.0, 0.22, 0.0), (2.0, 0.22, 1 / 3), (1.0, 0.35, 1 / 3), (5.0, 0.35, 1 / 3))


def main(scene: str) -> list[float]:
    """Return the can's height over the palm [m] at the end of each step."""
    model = mujoco.MjModel.from_xml_path(scene)
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key("start").id)
    mujoco.mj_forward(model, data)
    lift, wires = data.actuator("arm_gantry_z"), data.actuator("wire_motor")
    can, palm = data.body("soup_can_can"), data.body("gripper_palm")
    height, heights = data.joint("arm_gantry_z").qpos[0], []
    for duration, target, pwm in SCRIPT:
        start = data.time
        wires.ctrl[0] = pwm
        while (passed := data.time - start) < duration:
            lift.ctrl[0] = height + passed / duration * (target - height)
            mujoco.mj_step(model, data)
        height = target
        heights.append(float(can.xpos[2] - palm.xpos[2]))
    return heights


if __name__ == "__main__":
    _, grasped, lifted, held = main((sys.argv[1:] or ["models/scene.xml"])[0])
    print(f"The can slid {1e3 * (grasped - lifted):.2f} mm in the hand when lifted,")
    print(f"and {1e6 * (lifted - held) / 5:.2f} um/s afterwards.")
