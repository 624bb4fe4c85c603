"""A connection between a client and a server that loses answers."""
import socket
import threading


class LossyRelay:
    """Passes TCP connections on to a server's URL; of the first `lost` connections the request arrives and the answer
    does not."""

    def __init__(self, url, lost):
        host, port = url.removeprefix("http://").split(":")
        self._server, self._lost = (host, int(port)), lost
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.url = f"http://127.0.0.1:{self._listener.getsockname()[1]}"
        self.connections = 0

    def __enter__(self):
        threading.Thread(target=self._accept, daemon=True).start()
        return self

    def __exit__(self, *_):
        self._listener.shutdown(socket.SHUT_RDWR)
        self._listener.close()

    def _accept(self):
        while True:
            try:
                client, _ = self._listener.accept()
            except OSError:
                return
            self.connections += 1
            server = socket.create_connection(self._server)
            threading.Thread(target=self._pass_on, args=(client, server), daemon=True).start()
            back = self._lose_answer if self.connections <= self._lost else self._pass_on
            threading.Thread(target=back, args=(server, client), daemon=True).start()

    @staticmethod
    def _pass_on(source, target):
        try:
            while piece := source.recv(65536):
                target.sendall(piece)
            target.shutdown(socket.SHUT_WR)
        except OSError:
            pass  # the other direction has closed

    @staticmethod
    def _lose_answer(server, client):
        server.recv(65536)
        try:
            client.shutdown(socket.SHUT_RDWR)  # which ends the other direction too
        except OSError:
            pass  # the client has gone already
