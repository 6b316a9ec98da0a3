"""udsoncan reads and clears the fault codes of the ECU on a bus that behaves like CAN.

    python examples/uds/session.py

Needs ``canroll[uds]``. Tester and ECU are two nodes of simbus, with can-isotp between. The ECU
hears no sensors, so that it has fault codes.
"""

import isotp
import udsoncan
from udsoncan.client import Client
from udsoncan.connections import PythonIsoTpConnection
from udsoncan.exceptions import NegativeResponseException

from canroll.codegen.run import ecu_traffic
from canroll.codegen.run.bus_firmware import built_in
from canroll.extensions.services.ecu_on_bus import ecu_on_bus
from canroll.extensions.services.running import uds_frames

SECONDS = 60.0
"""The tester waits so long for a response: on a busy machine the ECU's thread may be late."""
WORDS = {0x0101: "time", 0x0102: "speed", 0x0103: "roll rate", 0x0104: "lateral acceleration"}


class Number(udsoncan.DidCodec):
    """A whole number, the highest byte first."""

    def __init__(self, size: int) -> None:
        self.size = size

    def encode(self, number: int) -> bytes:
        """Not used: the ECU writes nothing by identifier."""
        return number.to_bytes(self.size, "big", signed=True)

    def decode(self, payload: bytes) -> int:
        """Read a number."""
        return int.from_bytes(payload, "big", signed=True)

    def __len__(self) -> int:
        return self.size


def main() -> None:
    """Read, clear, read again."""
    request, response = uds_frames(built_in())
    address = isotp.Address(isotp.AddressingMode.Normal_11bits, txid=request, rxid=response)
    settings = dict(udsoncan.configs.default_client_config)
    settings |= {
        "data_identifiers": {did: Number(4) for did in (*WORDS, 0x0110)}
        | {0x0100: Number(1), 0xF186: Number(1)},
        "use_server_timing": False,
        "request_timeout": SECONDS,
        "p2_timeout": SECONDS,
        "dtc_snapshot_did_size": 2,
    }
    calibration = ecu_traffic.random_calibration(3)
    with ecu_on_bus("uds example", calibration, ["uds"]) as bus:
        parameters = {"tx_padding": 0xCC, "rx_flowcontrol_timeout": 1000 * int(SECONDS)}
        stack = isotp.CanStack(bus, address=address, params=parameters)
        with Client(PythonIsoTpConnection(stack), config=settings) as client:
            values = client.read_data_by_identifier([0xF186, 0x0110]).service_data.values
            print(f"22: session {values[0xF186]}, calibration {values[0x0110]:08X}")
            while not client.get_number_of_dtc_by_status_mask(0x08).service_data.dtc_count:
                pass
            first = client.get_dtc_by_status_mask(0x08).service_data.dtcs[0]
            print(f"19 02: {first.id:06X}, status {first.status.get_byte_as_int():02X}")
            its = client.get_dtc_snapshot_by_dtc_number(first.id, 1).service_data.dtcs[0]
            names = [WORDS[each.did] for each in its.snapshots if each.did in WORDS]
            print(f"19 04: {', '.join(names)}")
            try:
                client.clear_dtc()
            except NegativeResponseException as error:
                print(f"14: {error.response.code_name}")
            client.change_session(3)
            client.clear_dtc()
            print("10 03, 14: cleared")


if __name__ == "__main__":
    main()
