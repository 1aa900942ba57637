import struct

from drake_srg.learning.event_log import EventLog, crc32c


def records(data):
    while data:
        (length,) = struct.unpack("<Q", data[:8])
        yield data[12 : 12 + length]
        data = data[16 + length :]


def test_the_checksum_is_that_of_rfc_3720():
    assert crc32c(bytes(32)) == 0x8A9136AA
    assert crc32c(b"123456789") == 0xE3069283


def test_a_file_says_its_version_and_then_the_scalars(tmp_path):
    with EventLog(tmp_path) as log:
        log.add(300, {"success": 0.5})
    (path,) = tmp_path.iterdir()
    version, scalar = records(path.read_bytes())
    assert version.endswith(b"\x1a\x0dbrain.Event:2")
    # Step 300 as a varint; a value with a tag and a float.
    tail = b"\x10\xac\x02\x2a\x10\x0a\x0e\x0a\x07success\x15" + struct.pack("<f", 0.5)
    assert scalar[9:] == tail


def test_a_second_log_goes_on(tmp_path):
    for step in (1, 2):
        with EventLog(tmp_path) as log:
            log.add(step, {"a": 1.0})
    (path,) = tmp_path.iterdir()
    assert len(list(records(path.read_bytes()))) == 3
