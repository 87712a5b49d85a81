"""Load diffusion models: by id or from a folder, on the device that is there. The only user of torch.

Weights are read from safetensors only, and no code that comes with a model is run: a pickled file, as `.bin`
is, may run anything. torch, diffusers and transformers are the extra `inpaint`, so they are imported inside
the functions.
"""

import contextlib
import importlib.util
import logging
import os
import re
import socket
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from laesi_tf.common.errors import InputError

CONTROLNET_ID = "lllyasviel/control_v11p_sd15_canny"
BASE_ID = "stable-diffusion-v1-5/stable-diffusion-inpainting"
"""The first inpainting model of Stable Diffusion 1.5, which `runwayml` published, where it lives now."""
_PACKAGES = ("torch", "diffusers", "transformers", "accelerate")
_TIMEOUT_S = 5.0
_ID = re.compile(r"[A-Za-z0-9][\w.-]*/[\w.-]+")


def require_packages() -> None:
    """Raise InputError if a package of the extra `inpaint` is missing."""
    missing = [name for name in _PACKAGES if importlib.util.find_spec(name) is None]
    if missing:
        raise InputError(f"{missing[0]} is not installed; run pip install -c constraints.txt -e '.[inpaint]'")


def require_model_name(name: str, flag: str) -> None:
    """Raise InputError unless `name` is a folder or may be an id, owner/name, on Hugging Face."""
    if not Path(name).is_dir() and not _ID.fullmatch(name):
        raise InputError(f"{flag} {name}: there is no such folder, and it is no id such as {CONTROLNET_ID}")


def choose_device(name: str) -> str:
    """Return the device `name`; for `auto` the first of cuda, mps, cpu that is there. Raises InputError."""
    import torch

    available = {
        "cuda": torch.cuda.is_available(),
        "mps": torch.backends.mps.is_available(),
        "cpu": True,
    }
    kind = name.partition(":")[0]
    if name == "auto":
        return next(device for device, is_there in available.items() if is_there)
    if not available.get(kind, False):
        there = ", ".join(device for device, is_there in available.items() if is_there)
        raise InputError(f"--device {name} is not available on this machine; there is: {there}")
    return name


def make_generator(seed: int) -> Any:
    """Return a random generator on the CPU: its numbers are the same whatever the device."""
    import torch

    return torch.Generator("cpu").manual_seed(seed)


def load_pipeline(base: str, controlnet: str, *, device: str, is_half: bool) -> Any:
    """Load a StableDiffusionControlNetInpaintPipeline on `device`. Raises InputError.

    The scheduler is UniPC: 20 of its steps are about as good as 50 of older ones. The safety checker is left
    out: it looks for nudity, and would turn the leaves that it suspects black.
    """
    with _quiet_libraries():
        import torch
        from diffusers import (
            ControlNetModel,
            StableDiffusionControlNetInpaintPipeline,
            UniPCMultistepScheduler,
        )

        options: dict[str, Any] = {
            "use_safetensors": True,
            "dtype": torch.float16 if is_half else torch.float32,
        }
        network = _load(ControlNetModel, controlnet, "--controlnet", options)
        options |= {"controlnet": network, "safety_checker": None, "requires_safety_checker": False}
        pipeline = _load(StableDiffusionControlNetInpaintPipeline, base, "--base", options)
        pipeline.scheduler = UniPCMultistepScheduler.from_config(pipeline.scheduler.config)
    pipeline.set_progress_bar_config(disable=True)
    return pipeline.to(device)


def _load(cls: Any, name: str, flag: str, options: dict[str, Any]) -> Any:
    """Load a model from the folder `name`, from the cache, or from the network, in this order."""
    if Path(name).is_dir():
        try:
            return cls.from_pretrained(name, local_files_only=True, **options)
        except Exception as error:  # These libraries raise almost anything for a broken folder
            raise InputError(
                f"{flag} {name} cannot be loaded ({_first_line(error)}); name a folder that diffusers' "
                "save_pretrained wrote, with its weights as safetensors"
            ) from None
    try:
        return cls.from_pretrained(name, local_files_only=True, **options)
    except Exception:
        _require_network(name, flag)
    try:
        return cls.from_pretrained(name, **options)
    except Exception as error:
        raise InputError(_unavailable_message(name, flag, _first_line(error))) from None


def _require_network(name: str, flag: str) -> None:
    """Raise InputError if the model hub cannot be reached: it would be tried for half a minute otherwise."""
    if any(os.environ.get(proxy) for proxy in ("HTTPS_PROXY", "https_proxy", "ALL_PROXY", "all_proxy")):
        return
    hub = urlsplit(os.environ.get("HF_ENDPOINT", "https://huggingface.co"))
    try:
        socket.create_connection((hub.hostname or "", hub.port or 443), timeout=_TIMEOUT_S).close()
    except OSError as error:
        reason = f"no network: {hub.hostname}: {error.strerror or error}"
        raise InputError(_unavailable_message(name, flag, reason)) from None


def _unavailable_message(name: str, flag: str, reason: str) -> str:
    return (
        f"{name} is neither a folder nor in the cache and cannot be downloaded ({reason}); download "
        f"{CONTROLNET_ID} and {BASE_ID} elsewhere (hf download ID --local-dir DIR), then name the folder: "
        f"{flag} DIR"
    )


def _first_line(error: Exception) -> str:
    return (str(error).strip() or type(error).__name__).splitlines()[0][:200]


@contextlib.contextmanager
def _quiet_libraries() -> Iterator[None]:
    """Hide what the libraries log, warn of, and draw while they load; restore it afterwards."""
    import diffusers.utils.logging as diffusers_logging
    import transformers.utils.logging as transformers_logging

    modules = (diffusers_logging, transformers_logging)
    levels = [module.get_verbosity() for module in modules]
    disabled = logging.root.manager.disable
    logging.disable(logging.WARNING)
    for module in modules:
        module.set_verbosity_error()
        module.disable_progress_bar()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    finally:
        logging.disable(disabled)
        for module, level in zip(modules, levels, strict=True):
            module.set_verbosity(level)
            module.enable_progress_bar()
