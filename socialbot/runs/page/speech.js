// Utterances in progress at a time, and the caption to show.

const READ_S = 3;
const LETTER_S = 0.12; // slower than any voice

/** Whether an utterance can still last at `at`: a node that crashed reports no end. */
function lasts({ text, since_s: since }, at) {
  return at - since < READ_S + text.length * LETTER_S;
}

/** Utterances that are being spoken at `at`. */
export function spoken(speech, at) {
  return speech.filter(each => each.state === 'started' && lasts(each, at));
}

/**
 * The utterance to show as a caption: the one being spoken, else one that ended just now, else one of a robot whose
 * speech node reports nothing.
 */
export function caption(speech, at) {
  return spoken(speech, at).at(-1)
    ?? speech.findLast(each => each.state === 'finished' && at - each.since_s < READ_S)
    ?? speech.findLast(each => each.state === 'waiting' && lasts(each, at));
}
