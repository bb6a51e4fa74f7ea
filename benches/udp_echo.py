"""Sends each datagram back to whom it came from: what `city3d bench link` compares the link with."""

import socket

with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as echo:
    echo.bind(("127.0.0.1", 0))
    print("127.0.0.1:%d" % echo.getsockname()[1], flush=True)
    while True:
        data, sender = echo.recvfrom(2048)
        echo.sendto(data, sender)
