"""Geometry of the SAKE Robotics gripper (SRG).

Planning, experiments and the model builder (tools/models/srg.py) read these numbers.
The tests compare them with models/sdf/srg.sdf.

Palm frame: x points out of the palm, and the two mirrored fingers move in the x-y
plane. Link frames: at the link's hinge, with x along the link, y inwards (the closing
side) and z along the hinge. Joint angles are 0 with the fingers straight and fully
open, 180 degrees apart, and increase as they close.
"""

import dataclasses as dc


@dc.dataclass(frozen=True)
class SrgGeometry:
    """Lengths [m], angles [rad] and speeds [rad/s] of the SRG (EZGripper gen 2)."""

    # From SAKE's public gen-2 articulated URDF (SAKErobotics/EZGripper): position of
    # the base hinges in the palm frame (the second one is mirrored in y), distance from
    # base hinge to tip hinge, largest angle of every joint, and top speed.
    hinge_x: float = 0.072569
    hinge_y: float = 0.03
    base_length: float = 0.052
    joint_limit: float = 1.94
    joint_speed: float = 3.67

    # Distance of the faces of base link and pad from the line through the hinges,
    # inwards. In the same URDF with its meshes, the gap between the pads at a base
    # angle of 90 degrees is 0.0416, so this is hinge_y - 0.0416 / 2.
    face_offset: float = 0.0092
    # End of the pad, along the tip link from its hinge. In the same URDF with its
    # meshes, the straight finger has 0.1108 from base hinge to fingertip, so this is
    # 0.1108 - base_length.
    pad_end: float = 0.0588

    # Bounding boxes of the vendor's STL parts. The palm's length is along its x, its
    # width along y, and its height along z.
    pad_length: float = 0.0500
    pad_width: float = 0.0303
    pad_thickness: float = 0.0150
    palm_length: float = 0.0791
    palm_width: float = 0.0816
    palm_height: float = 0.0653

    # From our model, not the vendor's: x of the palm's flat face and of the frame
    # `grasp_center`. With the fingers straight at 90 degrees, that frame is 5 mm beyond
    # the middle of the pads.
    palm_face_x: float = 0.072
    grasp_center_x: float = 0.1631

    # From the SRG thesis: sum of base and tip angle of an empty hand at closure 1.
    full_scale: float = 3.0

    @property
    def finger_length(self) -> float:
        """Distance from the base hinge to the end of the pad, finger straight [m]."""
        return self.base_length + self.pad_end

    @property
    def pad_middle(self) -> float:
        """Middle of the pad, along the tip link from its hinge [m]."""
        return round(self.pad_end - 0.5 * self.pad_length, 9)

    @property
    def parallel_gap(self) -> float:
        """Gap between parallel pads with the base links pointing sideways [m]."""
        return 2.0 * (self.hinge_y + self.base_length - self.face_offset)


SRG = SrgGeometry()
