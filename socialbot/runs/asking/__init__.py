"""Questions about a run in plain language: why something was done or left undone, what is seen, done and intended.

`answer` is the entry point for the terminal and the page of a run, `answer_heard` for speech. A question is read in two
steps: its parts are found (people, times, classes of words, deeds of the run), and each kind of question with each deed
is ranked by learned weights; no fixed sentences are known. Each clause of an answer names the records behind it. What
no record supports is answered with "I don't know".
"""

from socialbot.runs.asking._answers import Answer, answer, answer_heard, is_asked, words_of_names
from socialbot.runs.asking._options import asking_back, chosen_option
from socialbot.runs.asking._sentences import Claim, Clause
from socialbot.runs.asking.languages import LANGUAGES

__all__ = [
    "LANGUAGES", "Answer", "Claim", "Clause", "answer", "answer_heard", "asking_back", "chosen_option", "is_asked",
    "words_of_names",
]  # fmt: skip
