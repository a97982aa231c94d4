"""What Phase II learns from: photos with the light found for them, and the object under generated lights."""

from lightprobe.lessons.lesson import Lesson
from lightprobe.lessons.lessons import collect_lessons

__all__ = ["Lesson", "collect_lessons"]
