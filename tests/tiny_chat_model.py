"""Chat models of tiny sizes with random weights, one that talks and one that sees as well, written to folders as real
ones are. What they say means nothing.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

WORDS = ("yes", "no", "{", "}", '"', ":", ",", "complete", "cup", "is", "the", "held", "open", "user", "system")
SPECIAL = ("<pad>", "<s>", "</s>", "<unk>", "<image>")
TEMPLATE = (
    "{% for message in messages %}{{ message['role'] }} : "
    "{% if message['content'] is string %}{{ message['content'] }}{% else %}"
    "{% for part in message['content'] %}"
    "{% if part['type'] == 'image' %}<image> {% else %}{{ part['text'] }} {% endif %}"
    "{% endfor %}{% endif %}</s>{% endfor %}"
)
PATCHES, PATCH_PX = 4, 8  # of the picture, along a side; and of one


def write_talking(folder: Path, seed: int = 0) -> Path:
    """The folder of a model that reads text: Llama's kind, one layer."""
    from transformers import LlamaConfig, LlamaForCausalLM

    tokenizer = _tokenizer()
    _save(lambda: LlamaForCausalLM(LlamaConfig(**_sizes(tokenizer))), tokenizer, folder, seed)
    tokenizer.save_pretrained(str(folder))
    return folder


def write_seeing(folder: Path, seed: int = 0) -> Path:
    """The folder of a model that reads text and sees pictures: LLaVA's kind, of one layer each."""
    from transformers import (
        CLIPImageProcessor,
        CLIPVisionConfig,
        LlamaConfig,
        LlavaConfig,
        LlavaForConditionalGeneration,
        LlavaProcessor,
    )

    tokenizer = _tokenizer()
    size = PATCHES * PATCH_PX
    config = LlavaConfig(
        vision_config=CLIPVisionConfig(
            hidden_size=16, intermediate_size=16, num_hidden_layers=2, num_attention_heads=2, image_size=size,
            patch_size=PATCH_PX, projection_dim=16,
        ),
        text_config=LlamaConfig(**_sizes(tokenizer)),
        image_token_index=tokenizer.convert_tokens_to_ids("<image>"),
        image_seq_length=PATCHES**2,
    )  # fmt: skip
    _save(lambda: LlavaForConditionalGeneration(config), tokenizer, folder, seed)
    LlavaProcessor(
        CLIPImageProcessor(size={"shortest_edge": size}, crop_size={"height": size, "width": size}),
        tokenizer,
        patch_size=PATCH_PX,
        vision_feature_select_strategy="default",
        num_additional_image_tokens=1,
        chat_template=TEMPLATE,
    ).save_pretrained(str(folder))
    return folder


def _sizes(tokenizer: Any) -> dict[str, Any]:
    return {
        "vocab_size": len(tokenizer),
        "hidden_size": 16,
        "intermediate_size": 16,
        "num_hidden_layers": 1,
        "num_attention_heads": 2,
        "max_position_embeddings": 4096,
        "bos_token_id": tokenizer.bos_token_id,
        "eos_token_id": tokenizer.eos_token_id,
        "pad_token_id": tokenizer.pad_token_id,
    }


def _tokenizer() -> Any:
    """Words between blanks; whatever it does not know is one unknown word."""
    from tokenizers import Tokenizer, models, pre_tokenizers
    from transformers import PreTrainedTokenizerFast

    known = {word: index for index, word in enumerate(SPECIAL + WORDS)}
    base = Tokenizer(models.WordLevel(known, unk_token="<unk>"))
    base.pre_tokenizer = pre_tokenizers.WhitespaceSplit()
    return PreTrainedTokenizerFast(
        tokenizer_object=base,
        pad_token="<pad>",
        bos_token="<s>",
        eos_token="</s>",
        unk_token="<unk>",
        additional_special_tokens=["<image>"],
        chat_template=TEMPLATE,
    )


def _save(make: Any, tokenizer: Any, folder: Path, seed: int) -> None:
    """Write a model that ends by chance, after some twenty words, which is soon."""
    import torch
    from transformers import GenerationConfig

    folder.mkdir(parents=True, exist_ok=True)
    state = torch.get_rng_state()
    torch.manual_seed(seed)
    model = make()
    torch.set_rng_state(state)
    model.generation_config = GenerationConfig(
        do_sample=True,
        max_new_tokens=64,
        bos_token_id=tokenizer.bos_token_id,
        eos_token_id=tokenizer.eos_token_id,
        pad_token_id=tokenizer.pad_token_id,
    )
    model.save_pretrained(str(folder))
