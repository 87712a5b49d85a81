"""A tiny Stable Diffusion with random weights, as `save_pretrained` writes it: it runs in milliseconds."""

import json
from pathlib import Path

BLOCKS = {
    "block_out_channels": (8, 16),
    "layers_per_block": 1,
    "cross_attention_dim": 16,
    "attention_head_dim": 2,
    "norm_num_groups": 4,
    "down_block_types": ("DownBlock2D", "CrossAttnDownBlock2D"),
}


def save_tiny_models(folder: Path) -> tuple[Path, Path]:
    """Save an inpainting pipeline and a ControlNet; return their folders."""
    import torch
    from diffusers import (
        AutoencoderKL,
        ControlNetModel,
        PNDMScheduler,
        StableDiffusionControlNetInpaintPipeline,
        UNet2DConditionModel,
    )
    from transformers import CLIPTextConfig, CLIPTextModel, CLIPTokenizer

    # More threads wait for one another longer than they compute.
    torch.set_num_threads(1)
    torch.manual_seed(0)
    # 9 channels: noise, masked image and mask, as the inpainting models have.
    unet = UNet2DConditionModel(
        **BLOCKS,
        sample_size=8,
        in_channels=9,
        out_channels=4,
        up_block_types=("CrossAttnUpBlock2D", "UpBlock2D"),
    )
    controlnet = ControlNetModel(**BLOCKS, in_channels=4, conditioning_embedding_out_channels=(8, 8, 8, 8))
    autoencoder = AutoencoderKL(
        block_out_channels=[8, 8, 8, 8],
        down_block_types=["DownEncoderBlock2D"] * 4,
        up_block_types=["UpDecoderBlock2D"] * 4,
        layers_per_block=1,
        norm_num_groups=4,
    )
    vocabulary = _write_vocabulary(folder / "vocabulary")
    encoder = CLIPTextModel(
        CLIPTextConfig(
            hidden_size=16,
            intermediate_size=16,
            num_attention_heads=2,
            num_hidden_layers=1,
            vocab_size=vocabulary,
            bos_token_id=vocabulary - 2,
            eos_token_id=vocabulary - 1,
            pad_token_id=vocabulary - 1,
        )
    )
    pipeline = StableDiffusionControlNetInpaintPipeline(
        vae=autoencoder,
        text_encoder=encoder,
        tokenizer=CLIPTokenizer.from_pretrained(folder / "vocabulary", model_max_length=77),
        unet=unet,
        controlnet=controlnet,
        scheduler=PNDMScheduler(skip_prk_steps=True, steps_offset=1),
        safety_checker=None,
        feature_extractor=None,
        requires_safety_checker=False,
    )
    pipeline.save_pretrained(folder / "base")
    controlnet.save_pretrained(folder / "controlnet")
    return folder / "base", folder / "controlnet"


def _write_vocabulary(folder: Path) -> int:
    """Write the files of a tokenizer that knows letters only; return the number of its tokens."""
    letters = [chr(code) for code in (*range(33, 127), *range(161, 173), *range(174, 324))]
    tokens = [*letters, *(f"{letter}</w>" for letter in letters), "<|startoftext|>", "<|endoftext|>"]
    folder.mkdir()
    (folder / "vocab.json").write_text(json.dumps({token: number for number, token in enumerate(tokens)}))
    (folder / "merges.txt").write_text("#version: 0.2\n")
    return len(tokens)
