"""An MX-64 whose registers tests write and read through packets."""

from drake_srg.bridges.dynamixel.mx64 import Mx64
from drake_srg.bridges.dynamixel.protocol import (
    Error,
    Instruction,
    Packet,
    PacketReader,
)
from drake_srg.bridges.dynamixel.registers import REGISTERS
from drake_srg.gripper.motor_temperature import MotorTemperatureConfig
from drake_srg.gripper.tendon import TendonDriveConfig

DRIVE = TendonDriveConfig()
ADDRESS = {register.name: register for register in REGISTERS}


class ServoWithMaster(Mx64):
    """A servo whose registers can be written and read by name through packets.

    Attributes:
        warned: Kinds of the warnings so far.
        now: Simulated time [s].
    """

    def __init__(self, **heat):
        self.warned = []
        heat = MotorTemperatureConfig(**heat)
        super().__init__(DRIVE, heat, lambda kind, message: self.warned.append(kind))
        self.now = 0.0

    def send(self, code, parameters=b"", number=1):
        replies = self.answer(Packet(number, code, bytes(parameters)))
        return list(PacketReader().feed(replies, 0.0))

    def write(self, name, value, code=Instruction.WRITE):
        register = ADDRESS[name]
        value &= (1 << 8 * register.size) - 1
        data = value.to_bytes(register.size, "little")
        (status,) = self.send(code, [register.address, *data])
        return Error(status.code)

    def read(self, name):
        register = ADDRESS[name]
        (status,) = self.send(Instruction.READ, [register.address, register.size])
        return int.from_bytes(status.parameters, "little", signed=register.signed)

    def move(self, angle=0.0, speed=0.0, pwm=0.0, temperature=25.0, lasting=0.005):
        for _ in range(round(lasting / 0.005)):
            self.now += 0.005
            self.sense(self.now, angle, speed, pwm, temperature)
