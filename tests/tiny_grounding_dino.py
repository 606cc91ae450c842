"""A Grounding DINO of tiny sizes with random weights, and its processor, written to a folder as real ones are."""

from __future__ import annotations

from pathlib import Path

WORDS = ("[PAD]", "[UNK]", "[CLS]", "[SEP]", "[MASK]", ".", "cup", "bowl", "can", "of", "soda", "trash", "red", "##s")


def write_tiny(folder: Path, seed: int = 0) -> Path:
    """The folder, with 20 queries, texts of up to 64 tokens, and pictures shrunk to 64 px; the words are `WORDS`."""
    import torch
    from transformers import (
        BertConfig,
        BertTokenizerFast,
        GroundingDinoConfig,
        GroundingDinoForObjectDetection,
        GroundingDinoImageProcessor,
        GroundingDinoProcessor,
        SwinConfig,
    )

    folder.mkdir(parents=True, exist_ok=True)
    (folder / "vocab.txt").write_text("\n".join(WORDS))
    tokenizer = BertTokenizerFast.from_pretrained(str(folder))
    images = GroundingDinoImageProcessor(size={"shortest_edge": 64, "longest_edge": 96})
    config = GroundingDinoConfig(
        backbone_config=SwinConfig(
            embed_dim=8, depths=[1] * 4, num_heads=[1] * 4, window_size=4, image_size=64, out_indices=[2, 3, 4]
        ),
        text_config=BertConfig(
            vocab_size=len(WORDS), hidden_size=16, num_hidden_layers=1, num_attention_heads=2, intermediate_size=16
        ),
        d_model=32, encoder_layers=1, decoder_layers=2, encoder_attention_heads=2, decoder_attention_heads=2,
        encoder_ffn_dim=16, decoder_ffn_dim=16, num_queries=20, max_text_len=64,
    )  # fmt: skip
    state = torch.get_rng_state()
    torch.manual_seed(seed)
    GroundingDinoForObjectDetection(config).save_pretrained(str(folder))
    torch.set_rng_state(state)
    GroundingDinoProcessor(images, tokenizer).save_pretrained(str(folder))
    return folder
