"""The parameters of the panel."""

from crane_nodes.parameters import Number, Text

ADDRESS = Text(
    "address",
    "127.0.0.1",
    "Address to listen on; 127.0.0.1: this computer alone, 0.0.0.0: every network it is in, "
    "without encryption. At the start",
)
PORT = Number(
    "port", 8060, "-", 0, 65535, "Port to listen on; 0: any that is free. At the start", whole=True
)
NAMES = Text(
    "names",
    "",
    "Names of this computer, separated by blanks, by which browsers may ask for the page, beside "
    "localhost and addresses in digits. At the start",
)
PARAMETERS = (ADDRESS, PORT, NAMES)
