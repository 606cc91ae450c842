"""The `grounding_dino` detector: Grounding DINO by transformers (Paper, Navigation appendix)."""

from __future__ import annotations

import inspect
from collections.abc import Iterator, Mapping, Sequence
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mpvi_bt.finding.perception.detector import ROBOT, Detection
from mpvi_bt.ground.errors import DetectorError, shown
from mpvi_bt.ground.extras import install
from mpvi_bt.ground.robot.protocol import CameraImage
from mpvi_bt.ground.words.phrases import asked, read

MODEL = "IDEA-Research/grounding-dino-tiny"
KINDS = ("grounding-dino", "mm-grounding-dino")  # they speak alike

_NEEDED = "grounding_dino needs torch and transformers"


class GroundingDinoDetector:
    """Boxes by phrase, without masks, from the picture's colors alone.

    Phrases are handed over in one text, without articles and without what they say of a place, each ended by a period;
    in several texts where one would be too long. Which phrase a box is of follows from the words that the model says it
    is of, see `phrases.asked`. `ROBOT` is not asked for: the model does not know which robot it looks out of.

    Attributes:
        name: "grounding_dino", with the model's id or folder unless it is the usual one.
        device: Where the model is, such as "cpu".
    """

    def __init__(
        self,
        model: str = MODEL,
        box_threshold: float = 0.35,
        text_threshold: float = 0.25,
        device: str | None = None,
    ) -> None:
        """Load the model.

        Args:
            model: Id at the Hugging Face hub, or a folder that `save_pretrained` wrote model and processor to.
            box_threshold: Boxes of lower scores are dropped, 0 to 1 (the model's authors' value).
            text_threshold: A box is of the words that score as much for it (likewise).
            device: Of torch; by default the first GPU if there is one.

        Raises:
            DetectorError: The extra is not installed, or the model is neither here nor can be downloaded.
        """
        self.name = "grounding_dino" if model == MODEL else f"grounding_dino:{model}"
        self._box_threshold, self._text_threshold = box_threshold, text_threshold
        try:
            import torch
        except ImportError as error:
            raise DetectorError("not_installed", f"{_NEEDED}: {install('grounding-dino')}") from error
        self._torch = torch
        self.device = device or ("cuda" if torch.cuda.is_available() else "cpu")
        self._processor, self._model = _load(model, self.device)
        self._most_tokens = int(getattr(self._model.config, "max_text_len", 256))

    def detect(self, image: CameraImage, phrases: Sequence[str]) -> list[Detection]:
        """As `Detector` says; the labels and the depth of the picture are not looked at."""
        said = {phrase: _spoken(phrase) for phrase in dict.fromkeys(phrases)}
        of_text: dict[str, list[str]] = {}
        for phrase, text in said.items():
            if text:
                of_text.setdefault(text, []).append(phrase)
        found = []
        for texts in self._batches(list(of_text)):
            for text, score, box in self._run(image.rgb, texts):
                found += [Detection(phrase, score, box.copy()) for phrase in of_text[text]]
        return found

    def _batches(self, texts: Sequence[str]) -> Iterator[list[str]]:
        """The texts in as few groups as the length of the model's input allows; what does not fit alone is left out."""
        batch: list[str] = []
        for text in texts:
            if self._tokens([text]) > self._most_tokens:
                continue
            if batch and self._tokens([*batch, text]) > self._most_tokens:
                yield batch
                batch = []
            batch.append(text)
        if batch:
            yield batch

    def _tokens(self, texts: Sequence[str]) -> int:
        return len(self._processor.tokenizer(prompt(texts))["input_ids"])

    def _run(self, rgb: NDArray[np.uint8], texts: Sequence[str]) -> Iterator[tuple[str, float, NDArray[np.intp]]]:
        """(text, score, box) of everything that the model finds of some texts."""
        height, width = rgb.shape[:2]
        inputs = self._processor(images=np.ascontiguousarray(rgb), text=prompt(texts), return_tensors="pt")
        inputs = inputs.to(self.device)
        with self._torch.inference_mode():
            outputs = self._model(**inputs)
        (result,) = self._found(outputs, inputs["input_ids"], (height, width))
        # Older versions call the words "labels", by which newer ones mean numbers; of no boxes some have one label, "".
        labels = result["text_labels"] if "text_labels" in result else result["labels"]
        for label, score, box in zip(labels, result["scores"].tolist(), result["boxes"].tolist(), strict=False):
            text = asked(label, texts)
            corners = np.clip(np.nan_to_num(box), 0, [width, height, width, height])
            outer = np.concatenate([np.floor(corners[:2]), np.ceil(corners[2:])]).astype(np.intp)
            if text is not None and (outer[2:] > outer[:2]).all():
                yield text, float(min(max(score, 0.0), 1.0)), outer

    def _found(self, outputs: Any, input_ids: Any, size: tuple[int, int]) -> list[Mapping[str, Any]]:
        """What the processor makes of the model's outputs, under whichever names its version knows the threshold."""
        read_out = self._processor.post_process_grounded_object_detection
        known = inspect.signature(read_out).parameters
        threshold = "threshold" if "threshold" in known else "box_threshold"
        options = {threshold: self._box_threshold, "text_threshold": self._text_threshold, "target_sizes": [size]}
        return list(read_out(outputs, input_ids, **options))


def prompt(texts: Sequence[str]) -> str:
    """The text that the model is trained on: lower case, each phrase ended by a period, as "a cat. a dog."."""
    return " ".join(f"{text.lower()}." for text in texts)


def _spoken(phrase: str) -> str:
    """What the model is asked: qualities and noun of a phrase; "" if it has no noun."""
    reading = read(phrase) if phrase != ROBOT else None
    return " ".join(reading.words) if reading is not None else ""


@lru_cache(maxsize=1)  # a run checks its choice first, and a suite has many episodes
def _load(model: str, device: str) -> tuple[Any, Any]:
    """Processor and model. Raises DetectorError."""
    try:
        from transformers import AutoModelForZeroShotObjectDetection, AutoProcessor
    except ImportError as error:
        raise DetectorError("not_installed", f"{_NEEDED}: {install('grounding-dino')}") from error
    try:
        processor = AutoProcessor.from_pretrained(model)
        network = AutoModelForZeroShotObjectDetection.from_pretrained(model).to(device).eval()
    except Exception as error:  # of the hub, of torch, of whatever reads the files
        raise DetectorError("not_loaded", f"{_mend(model)} ({_first_line(error)})") from error
    if (kind := network.config.model_type) not in KINDS:
        raise DetectorError("not_loaded", f"{shown(model)} is a model of kind {kind!r}; known: {', '.join(KINDS)}")
    return processor, network


def _mend(model: str) -> str:
    return (
        f"grounding_dino cannot load {shown(model)}: it is no folder with a model and its processor, and could not be "
        f"downloaded. Where there is a network: `hf download {MODEL} --local-dir FOLDER`; then choose "
        "--detector grounding_dino:FOLDER"
    )


def _first_line(error: Exception) -> str:
    return next(iter(str(error).splitlines()), type(error).__name__)[:200]
