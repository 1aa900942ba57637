"""Control tables: the registers of a servo, by name and by address."""

from __future__ import annotations

import abc
import dataclasses as dc
from collections.abc import Collection, Iterable, Sequence
from typing import ClassVar

from drake_srg.bridges.dynamixel.protocol import Refusal, RefusedError

VOLTAGE_UNIT = 0.1  # V, of limits and of the present voltage


@dc.dataclass(frozen=True)
class Register:
    """An entry of a control table.

    Attributes:
        address: Address of the first byte.
        name: The manual's name.
        size: Size in bytes: 1, 2 or 4.
        default: Value at power on.
        limits: Smallest and largest value that may be written; None if read only.
        signed: Whether the value is in two's complement.
        values: The values within the limits that may be written, if not all.
    """

    address: int
    name: str
    size: int
    default: int = 0
    limits: tuple[int, int] | None = None
    signed: bool = False
    values: tuple[int, ...] = ()

    @property
    def places(self) -> range:
        """Addresses of its bytes."""
        return range(self.address, self.address + self.size)

    def check(self, value: int, where: str) -> None:
        """Check a value that was written.

        Raises:
            RefusedError: If the register never takes it.
        """
        if self.limits is None:
            raise RefusedError(Refusal.ACCESS, f"{where}: {self.name} is read only")
        low, high = self.limits
        if not low <= value <= high or (self.values and value not in self.values):
            allowed = ", ".join(map(str, self.values)) or f"{low} to {high}"
            raise RefusedError(
                Refusal.RANGE, f"{where}: {self.name} must be {allowed}, got {value}"
            )


class ControlTable(abc.ABC):
    """The registers, as numbers by name and as the bytes that masters read.

    Attributes:
        registers: All of them, by address.
        ram: First address of the RAM. Registers below are in the EEPROM.
        size: Size in bytes.
    """

    registers: ClassVar[Sequence[Register]]
    ram: ClassVar[int]
    size: ClassVar[int]

    def __init__(self) -> None:
        self._bytes = bytearray(self.size)
        self._by_name = {register.name: register for register in self.registers}
        self._at = {place: r for r in self.registers for place in r.places}
        self.reset(self._by_name)

    def __getitem__(self, name: str) -> int:
        register = self._by_name[name]
        data = self._bytes[register.address : register.address + register.size]
        return int.from_bytes(data, "little", signed=register.signed)

    def __setitem__(self, name: str, value: int) -> None:
        register = self._by_name[name]
        value &= (1 << 8 * register.size) - 1
        end = register.address + register.size
        self._bytes[register.address : end] = value.to_bytes(register.size, "little")

    def reset(self, names: Iterable[str]) -> None:
        """Give registers their values at power on."""
        for name in names:
            self[name] = self._by_name[name].default

    def read(self, address: int, length: int) -> bytes:
        """Return bytes of the table, including those between registers.

        Raises:
            RefusedError: If the range exceeds the table.
        """
        if address + length > self.size:
            raise RefusedError(
                Refusal.ACCESS,
                f"cannot read {length} bytes at {address}: the table has {self.size} "
                "bytes",
            )
        return bytes(self._bytes[place] for place in self._places(address, length))

    def write(self, address: int, data: bytes) -> set[str]:
        """Write all bytes or none, and return the names of the registers written.

        Raises:
            RefusedError: If a register is missing or read only, or a value is invalid.
        """
        where = f"cannot write {data.hex(' ')} at {address}"
        if not data or address + len(data) > self.size:
            raise RefusedError(Refusal.ACCESS, f"{where}: no register there")
        places = self._places(address, len(data))
        touched = {
            self._at[place].name: self._at[place]
            for place in places
            if place in self._at
        }
        self._check_places(places, touched.values(), where)
        if self.locked and min(places) < self.ram:
            raise RefusedError(Refusal.ACCESS, f"{where}: the EEPROM is locked")
        before = self._bytes.copy()
        for place, byte in zip(places, data, strict=True):
            self._bytes[place] = byte
        try:
            for name, register in touched.items():
                register.check(self[name], where)
            self._check_limits(touched.keys(), where)
        except RefusedError:
            self._bytes = before
            raise
        return set(touched)

    @property
    @abc.abstractmethod
    def locked(self) -> bool:
        """Whether the EEPROM is locked."""

    def _places(self, address: int, length: int) -> Sequence[int]:
        """Return where the bytes of an address range are stored."""
        return range(address, address + length)

    @abc.abstractmethod
    def _check_places(
        self, places: Sequence[int], touched: Collection[Register], where: str
    ) -> None:
        """Check that these addresses may be written at once.

        Raises:
            RefusedError: If not.
        """

    @abc.abstractmethod
    def _check_limits(self, written: Collection[str], where: str) -> None:
        """Check registers that were written against the limits in other registers.

        Raises:
            RefusedError: If a value exceeds a limit.
        """
