"""A real browser without a window, driven through its debugging pipe."""

import json
import os
import shutil
import subprocess
import tempfile
import time
from typing import Any


def binary() -> str | None:
    """Chromium's path, where it is installed."""
    return next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)


class Browser:
    """One page of a new, empty profile. As a context manager it is gone afterwards."""

    def __init__(self) -> None:
        self._folder = tempfile.TemporaryDirectory(prefix="laesi-chromium-")
        reading, self._to = os.pipe()
        self._from, writing = os.pipe()
        command = [str(binary()), "--headless=new", "--no-sandbox", "--disable-gpu", "--no-first-run"]
        command += ["--enable-unsafe-swiftshader", "--window-size=1400,1600", "--disable-dev-shm-usage"]
        command += [f"--user-data-dir={self._folder.name}", "--remote-debugging-pipe", "about:blank"]

        def pipes() -> None:
            os.dup2(reading, 3)
            os.dup2(writing, 4)

        self._process = subprocess.Popen(
            command, preexec_fn=pipes, pass_fds=(3, 4), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )
        os.close(reading)
        os.close(writing)
        self._sent, self._rest, self._session = 0, b"", None
        page = next(t for t in self.call("Target.getTargets")["targetInfos"] if t["type"] == "page")
        attached = self.call("Target.attachToTarget", targetId=page["targetId"], flatten=True)
        self._session = attached["sessionId"]

    def __enter__(self) -> "Browser":
        return self

    def __exit__(self, *_: object) -> None:
        self._process.kill()
        self._process.wait()
        os.close(self._to)
        os.close(self._from)
        self._folder.cleanup()

    def call(self, method: str, **parameters: Any) -> dict[str, Any]:
        """The answer to one command of the DevTools protocol."""
        self._sent += 1
        message: dict[str, Any] = {"id": self._sent, "method": method, "params": parameters}
        if self._session:
            message["sessionId"] = self._session
        os.write(self._to, json.dumps(message).encode() + b"\0")
        while (answer := self._next()).get("id") != self._sent:
            pass
        return answer["result"]

    def evaluate(self, script: str) -> Any:
        """The value of a script in the page."""
        return self.call("Runtime.evaluate", expression=script, returnByValue=True)["result"].get("value")

    def until(self, script: str, seconds: float) -> Any:
        """The value of a script once it is true; TimeoutError if it is not in time."""
        begun = time.monotonic()
        while not (value := self.evaluate(script)):
            if time.monotonic() - begun > seconds:
                text = self.evaluate("document.body.innerText")
                raise TimeoutError(f"not within {seconds} s: {script}; the page says: {text[:500]}")
            time.sleep(0.05)
        return value

    def _next(self) -> dict[str, Any]:
        while b"\0" not in self._rest:
            part = os.read(self._from, 2**20)
            if not part:
                raise ConnectionError("the browser is gone")
            self._rest += part
        line, _, self._rest = self._rest.partition(b"\0")
        return json.loads(line)
