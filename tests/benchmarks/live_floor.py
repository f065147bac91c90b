"""The floor of any loop over this bus from Python: python-can alone answers the encoder frame.

`python live_floor.py PORT ENCODER_ID ANSWER_ID`, until it is ended. The answer gives the data back.
"""

import sys

import can


def main() -> None:
    port, encoder, answer = map(int, sys.argv[1:])
    with can.Bus(
        interface="udp_multicast", channel="239.74.163.2", hop_limit=0, fd=False, port=port
    ) as bus:
        while True:
            message = bus.recv()
            if message is not None and message.arbitration_id == encoder:
                bus.send(
                    can.Message(arbitration_id=answer, data=message.data, is_extended_id=False)
                )


if __name__ == "__main__":
    main()
