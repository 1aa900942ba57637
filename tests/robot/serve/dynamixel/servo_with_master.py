"""An MX-64 of either protocol whose registers tests write and read through packets."""

from drake_srg.gripper import SrgTendonDriver
from drake_srg.gripper.tendon import MotorTemperatureConfig
from drake_srg.robot.serve.dynamixel.mx64 import Mx64, Mx64P2
from drake_srg.robot.serve.dynamixel.protocol import (
    BROADCAST,
    Error1,
    Instruction,
    PacketReader,
    Refusal,
)
from drake_srg.robot.serve.dynamixel.servo import SpoolMotor


class WithMaster:
    """A servo whose registers can be written and read by name through packets.

    Attributes:
        errors: Error codes of the protocol's status packets.
        wrong_checksum: The one for that.
        identity: Reply to a ping.
        warned: Kinds of the warnings so far.
        now: Simulated time [s].
    """

    def __init__(self, **heat):
        self.warned = []
        driver = SrgTendonDriver(temperature=MotorTemperatureConfig(**heat))
        motor = SpoolMotor(driver)
        super().__init__(motor, lambda kind, message: self.warned.append(kind))
        self.now = 0.0
        self.register = {register.name: register for register in self.table.registers}

    def send(self, code, parameters=b"", number=1, intact=True):
        packet = self.table.packets(number, code, bytes(parameters), intact)
        return list(PacketReader(self.table.packets).feed(self.answer(packet), 0.0))

    def broadcast(self, code, parameters=b"", **options):
        return self.send(code, parameters, BROADCAST, **options)

    def words(self, *values):
        """Return the bytes of addresses and lengths."""
        return b"".join(map(self.number, values))

    def number(self, value, size=None):
        """Return the bytes of an address, a length or a value."""
        size = size or self.table.packets.width
        return (value & (1 << 8 * size) - 1).to_bytes(size, "little")

    def write(self, name, value, code=Instruction.WRITE):
        register = self.register[name]
        data = self.number(register.address) + self.number(value, register.size)
        (status,) = self.send(code, data)
        return self.error(status)

    def read(self, name):
        register = self.register[name]
        place = self.number(register.address) + self.number(register.size)
        (status,) = self.send(Instruction.READ, place)
        return int.from_bytes(self.data(status), "little", signed=register.signed)

    def move(self, angle=0.0, speed=0.0, pwm=0.0, temperature=25.0, lasting=0.005):
        for _ in range(round(lasting / 0.005)):
            self.now += 0.005
            self.sense(self.now, angle, speed, pwm, temperature)


class ServoWithMaster(WithMaster, Mx64):
    """A servo that speaks Protocol 1.0."""

    errors, wrong_checksum, identity = Error1, Error1.CHECKSUM, b""

    def error(self, status):
        return Error1(status.code)

    def data(self, status):
        return status.parameters


class ServoWithMaster2(WithMaster, Mx64P2):
    """A servo that speaks Protocol 2.0."""

    errors, wrong_checksum, identity = Refusal, Refusal.CHECKSUM, b"\x37\x01\x2d"

    def error(self, status):
        assert status.code == Instruction.STATUS
        return status.parameters[0]

    def data(self, status):
        return status.parameters[1:]
