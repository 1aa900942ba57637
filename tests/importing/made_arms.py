"""Descriptions of arms in URDF, made of cylinders."""

PI = 3.14159265358979

# Of each joint: name, origin in the parent and its rpy, axis, limit, effort.
JOINTS = [
    ("pan", "0 0 0.15", "0 0 0", "0 0 1", 3.1, 200),
    ("lift", "0 0.13 0", f"0 {PI / 2} 0", "0 1 0", 3.1, 200),
    ("elbow", "0 -0.11 0.42", "0 0 0", "0 1 0", 3.0, 150),
    ("wrist_1", "0 0 0.38", f"0 {PI / 2} 0", "0 1 0", 3.1, 40),
    ("wrist_2", "0 0.09 0", "0 0 0", "0 0 1", 3.1, 40),
    ("wrist_3", "0 0 0.09", "0 0 0", "0 1 0", 3.1, 40),
]
# Of each link: the origin of its cylinder and its rpy, radius, length, mass.
BODIES = [
    ("0 0 0.07", "0 0 0", 0.06, 0.14, 4.0),
    ("0 0.06 0", f"{PI / 2} 0 0", 0.05, 0.12, 3.0),
    ("0 0 0.21", "0 0 0", 0.045, 0.38, 6.0),
    ("0 0 0.19", "0 0 0", 0.04, 0.34, 2.0),
    ("0 0.05 0", f"{PI / 2} 0 0", 0.035, 0.08, 1.0),
    ("0 0 0.05", "0 0 0", 0.035, 0.08, 1.0),
    ("0 0.05 0", f"{PI / 2} 0 0", 0.035, 0.05, 0.3),
]
FLANGE = f"""
<link name="tool0"/>
<joint name="tool" type="fixed">
  <origin xyz="0 0.08 0" rpy="{-PI / 2} 0 0"/>
  <parent link="link6"/><child link="tool0"/>
</joint>"""


def link(name, origin, rpy, radius, length, mass):
    at = f'<origin xyz="{origin}" rpy="{rpy}"/>'
    shape = f'<geometry><cylinder radius="{radius}" length="{length}"/></geometry>'
    across, along = mass * (3 * radius**2 + length**2) / 12, mass * radius**2 / 2
    inertia = f'<inertia ixx="{across}" iyy="{across}" izz="{along}" ixy="0" '
    inertia += 'ixz="0" iyz="0"/>'
    return f"""
<link name="{name}">
  <inertial>{at}<mass value="{mass}"/>{inertia}</inertial>
  <visual>{at}{shape}</visual>
  <collision>{at}{shape}</collision>
</link>"""


def joint(name, origin, rpy, axis, limit, effort, parent, child):
    return f"""
<joint name="{name}" type="revolute">
  <origin xyz="{origin}" rpy="{rpy}"/>
  <parent link="{parent}"/><child link="{child}"/><axis xyz="{axis}"/>
  <limit lower="-{limit}" upper="{limit}" effort="{effort}" velocity="2.5"/>
</joint>"""


def six_axes():
    """Return the URDF of an arm with six joints, 0.8 m of links and a tool frame."""
    parts = [link(f"link{i}", *body) for i, body in enumerate(BODIES)]
    for i, given in enumerate(JOINTS):
        parts.append(joint(*given, f"link{i}", f"link{i + 1}"))
    return f'<robot name="six">{"".join(parts)}{FLANGE}</robot>'


def two_axes(extra="", **changes):
    """Return the URDF of a small arm, with texts replaced and elements added."""
    parts = [link(f"link{i}", *body) for i, body in enumerate(BODIES[:3])]
    for i, given in enumerate(JOINTS[:2]):
        parts.append(joint(*given, f"link{i}", f"link{i + 1}"))
    text = f'<robot name="two">{"".join(parts)}{extra}</robot>'
    for old, new in changes.get("replaced", []):
        assert old in text, old
        text = text.replace(old, new)
    return text
