"""The prediction job behind every door: command line, page, service and fleet.

    session = Session("runs/cup")
    request = PredictRequest(photo=Path("new.jpg"), method=Method.PROBE_NET)
    answer = predict_photo(session, request, AnswerFiles.within(Path("out"), request.outputs))

A door parses its input into a `PredictRequest` and shows the `Answer`. An option of predictions is one field of
`LightOptions` and its use.
"""

from lightprobe.jobs.files import AnswerFiles, ChosenFiles
from lightprobe.jobs.job import (
    EVERY,
    Answer,
    JointAnswer,
    VideoAnswer,
    locate_photos,
    predict_photo,
    predict_photos,
    predict_together,
    predict_video,
)
from lightprobe.jobs.photos import LocatedPhoto
from lightprobe.jobs.request import LightOptions, Output, PredictRequest
from lightprobe.jobs.session import Session, Sessions

__all__ = [
    "EVERY",
    "Answer",
    "AnswerFiles",
    "ChosenFiles",
    "JointAnswer",
    "LightOptions",
    "LocatedPhoto",
    "Output",
    "PredictRequest",
    "Session",
    "Sessions",
    "VideoAnswer",
    "locate_photos",
    "predict_photo",
    "predict_photos",
    "predict_together",
    "predict_video",
]
