"""A real browser without a window, driven through its debugging pipe."""

import base64
import contextlib
import json
import os
import shutil
import subprocess
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any


def binary() -> str | None:
    """Return Chromium's path; None if it is not installed."""
    return next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)


class Browser:
    """One page of a new, empty profile; leaving the context manager ends the browser."""

    def __init__(self, *, flags: Sequence[str] = ()) -> None:
        self.events: list[dict[str, Any]] = []
        """What the browser has reported of itself, for domains that were enabled."""
        self._profile = tempfile.TemporaryDirectory(prefix="laesi-chromium-", ignore_cleanup_errors=True)
        command_output, self._commands = os.pipe()
        self._answers, answer_input = os.pipe()
        command = [str(binary()), "--headless=new", "--no-sandbox", "--disable-gpu", "--no-first-run"]
        command += ["--enable-unsafe-swiftshader", "--window-size=1400,1600", "--disable-dev-shm-usage"]
        command += [*flags, f"--user-data-dir={self._profile.name}", "--remote-debugging-pipe", "about:blank"]

        def connect_pipes() -> None:
            os.dup2(command_output, 3)
            os.dup2(answer_input, 4)

        self._process = subprocess.Popen(
            command,
            preexec_fn=connect_pipes,
            pass_fds=(3, 4),
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        os.close(command_output)
        os.close(answer_input)
        self._sent, self._unread = 0, b""
        self._session: str | None = None
        page = next(t for t in self.call("Target.getTargets")["targetInfos"] if t["type"] == "page")
        attached = self.call("Target.attachToTarget", targetId=page["targetId"], flatten=True)
        self._session = attached["sessionId"]

    def __enter__(self) -> "Browser":
        return self

    def __exit__(self, *_: object) -> None:
        self._process.kill()
        self._process.wait()
        os.close(self._commands)
        os.close(self._answers)
        self._profile.cleanup()

    def call(self, method: str, **parameters: Any) -> dict[str, Any]:
        """Send one command of the DevTools protocol and return its result."""
        self._sent += 1
        message: dict[str, Any] = {"id": self._sent, "method": method, "params": parameters}
        if self._session:
            message["sessionId"] = self._session
        os.write(self._commands, json.dumps(message).encode() + b"\0")
        while (answer := self._read_message()).get("id") != self._sent:
            self.events.append(answer)
        if "error" in answer:
            raise RuntimeError(f"{method}: {answer['error']['message']}")
        result: dict[str, Any] = answer["result"]
        return result

    def evaluate(self, script: str) -> Any:
        """Return the value of a script in the page, or what its promise resolves to."""
        options = {"returnByValue": True, "awaitPromise": True, "userGesture": True}
        return self.call("Runtime.evaluate", expression=script, **options)["result"].get("value")

    def open(self, address: str, *, width: int = 1400, height: int = 1600, is_phone: bool = False) -> None:
        """Open a page in a window of so many CSS pixels."""
        metrics = {"width": width, "height": height, "deviceScaleFactor": 2 if is_phone else 1}
        self.call("Emulation.setDeviceMetricsOverride", **metrics, mobile=is_phone)
        self.call("Page.navigate", url=address)

    def choose_files(self, selector: str, files: Sequence[Path]) -> None:
        """Choose `files` in the field for files that `selector` names."""
        root = self.call("DOM.getDocument")["root"]["nodeId"]
        node = self.call("DOM.querySelector", nodeId=root, selector=selector)["nodeId"]
        self.call("DOM.setFileInputFiles", files=[str(file.resolve()) for file in files], nodeId=node)

    def press(self, key: str, code: int) -> None:
        """Press and release a key, such as Tab (9), Enter (13) or Escape (27)."""
        shared = {"key": key, "code": key, "windowsVirtualKeyCode": code}
        text = {"text": "\r"} if key == "Enter" else {}
        self.call("Input.dispatchKeyEvent", type="keyDown", **shared, **text)
        self.call("Input.dispatchKeyEvent", type="keyUp", **shared)

    def take_screenshot(self, path: Path) -> None:
        """Write what the window shows as PNG."""
        path.write_bytes(base64.b64decode(self.call("Page.captureScreenshot")["data"]))

    def wait_until(self, script: str, seconds: float) -> Any:
        """Wait until the value of a script is true and return it; raise TimeoutError after `seconds`."""
        started = time.monotonic()
        while not (value := self.evaluate(script)):
            if time.monotonic() - started > seconds:
                text = self.evaluate("document.body.innerText")
                raise TimeoutError(f"not true within {seconds} s: {script}; text of the page: {text[:500]}")
            time.sleep(0.05)
        return value

    def measure_memory_mb(self) -> float:
        """Return the memory of the browser's processes, with shared pages counted once, MB."""
        children: dict[str, list[str]] = {}
        for stat in Path("/proc").glob("[0-9]*/stat"):
            with contextlib.suppress(OSError):
                parent = stat.read_text().rpartition(")")[2].split()[1]
                children.setdefault(parent, []).append(stat.parent.name)
        processes = [str(self._process.pid)]
        for process in processes:
            processes += children.get(process, [])
        total = 0
        for process in processes:
            with contextlib.suppress(OSError):
                text = Path(f"/proc/{process}/smaps_rollup").read_text()
                total += int(text.partition("\nPss:")[2].split()[0])
        return total / 1024

    def _read_message(self) -> dict[str, Any]:
        while b"\0" not in self._unread:
            data = os.read(self._answers, 2**20)
            if not data:
                raise ConnectionError("the browser has ended")
            self._unread += data
        message, _, self._unread = self._unread.partition(b"\0")
        parsed: dict[str, Any] = json.loads(message)
        return parsed
