"""The `udp_multicast` bus of python-can without the echoes of what is sent.

python-can sends and receives through one socket, and every process on the multicast group is given
its own frames back. Here a second socket sends, and a filter in the kernel keeps its datagrams from
the socket that receives: nobody is woken for them.
"""

import ctypes
import select
import socket
import struct
from contextlib import suppress
from typing import Any

import can
from can.interfaces.udp_multicast import UdpMulticastBus
from can.interfaces.udp_multicast.utils import pack_message, unpack_message

LONGEST_DATAGRAM = 4096  # bytes; a frame of 64 bytes takes less than 300
TIMESPEC = struct.Struct("@ll")  # s, ns
STAMP = socket.CMSG_SPACE(TIMESPEC.size)

# linux/filter.h and asm-generic/socket.h: instructions of classic BPF, and what they can load
SO_ATTACH_FILTER = 26
INSTRUCTION = struct.Struct("=HBBI")
LOAD_WORD, LOAD_HALF, IF_EQUAL, RETURN = 0x20, 0x28, 0x15, 0x06
SOURCE_PORT = 0  # offset; the filter of a UDP socket sees datagrams from their UDP header on
PACKET_TYPE, INTERFACE = 0xFFFFF004, 0xFFFFF008
LOOPED_BACK, LOOPBACK_INTERFACE = 5, 1
DROP, WHOLE = 0, 0xFFFFFFFF  # bytes that pass


class EchoFreeMulticastBus(UdpMulticastBus):
    """An IPv4 multicast bus of Linux on which nobody hears itself.

    The frames are those of python-can: its own class may be at the other end. If the kernel refuses
    the filter, echoes come as they do with that class.
    """

    def __init__(
        self, channel: str, port: int = 43113, hop_limit: int = 1, fd: bool = True, **rest: Any
    ):
        """Parameters are those of `can.interfaces.udp_multicast.UdpMulticastBus`."""
        super().__init__(channel, port, hop_limit, fd=fd, **rest)
        self._group = (channel, port)
        self._receiver = socket.socket(fileno=socket.dup(self.fileno()))
        self._sender = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._sender.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, hop_limit)
        self._sender.bind(("", 0))
        with suppress(OSError):
            _refuse_own(self._receiver, self._sender.getsockname()[1])

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Send a frame to the group; a datagram is sent at once, so `timeout` [s] has no effect."""
        if msg.is_fd and self.protocol is not can.CanProtocol.CAN_FD:
            raise can.CanOperationError("cannot send a CAN FD frame: CAN FD is disabled")
        try:
            self._sender.sendto(pack_message(msg), self._group)
        except OSError as error:
            raise can.CanOperationError(f"failed to send via socket: {error}") from error

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        """The next frame and False: it is not filtered. None after `timeout` [s], and instead of a
        datagram that is not a frame of this bus.
        """
        if not select.select([self._receiver], [], [], timeout)[0]:
            return None, False
        try:
            data, ancillary, _, _ = self._receiver.recvmsg(
                LONGEST_DATAGRAM, STAMP, socket.MSG_DONTWAIT
            )
        except BlockingIOError:  # its checksum was wrong
            return None, False
        seconds, nanoseconds = TIMESPEC.unpack(ancillary[0][2])
        try:
            stamp = {"timestamp": seconds + nanoseconds * 1e-9}
            message = unpack_message(data, stamp, check=True)
        except Exception:  # whatever a stranger on this port sends
            return None, False
        if message.is_fd and self.protocol is not can.CanProtocol.CAN_FD:
            return None, False
        return message, False

    def shutdown(self) -> None:
        """Close all sockets."""
        super().shutdown()
        self._receiver.close()
        self._sender.close()


def _refuse_own(receiver: socket.socket, port: int) -> None:
    """Keep datagrams that this computer sends from `port` out of `receiver`.

    Those of another computer may come from a port of the same number. Multicast datagrams of this
    one are looped back on their way out, or go through the loopback interface.
    """
    program = (
        (LOAD_HALF, 0, 0, SOURCE_PORT),
        (IF_EQUAL, 0, 4, port),
        (LOAD_WORD, 0, 0, PACKET_TYPE),
        (IF_EQUAL, 3, 0, LOOPED_BACK),
        (LOAD_WORD, 0, 0, INTERFACE),
        (IF_EQUAL, 1, 0, LOOPBACK_INTERFACE),
        (RETURN, 0, 0, WHOLE),
        (RETURN, 0, 0, DROP),
    )  # each: code, instructions to skip if equal, and if not, operand
    packed = b"".join(INSTRUCTION.pack(*instruction) for instruction in program)
    instructions = ctypes.create_string_buffer(packed, len(packed))
    description = struct.pack("@HP", len(program), ctypes.addressof(instructions))
    receiver.setsockopt(socket.SOL_SOCKET, SO_ATTACH_FILTER, description)
