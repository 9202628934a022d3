// The server sends an event every five seconds at least; the connection is lost after this time without one.
const SILENT_MS = 15_000;
const AGAIN_MS = 2000;

/** Subscribes to a live run; reconnects and reloads after a lost connection. */
export function listen(hearer) {
  const source = new EventSource('/api/live');
  const left = new AbortController();
  let silence;

  function leave() {
    left.abort();
    clearTimeout(silence);
    source.close();
  }

  function comeBack(wait) {
    leave();
    hearer.lost();
    setTimeout(() => listen(hearer), wait);
  }

  function hear(name, take) {
    source.addEventListener(name, event => {
      clearTimeout(silence);
      silence = setTimeout(() => comeBack(0), SILENT_MS);
      take(JSON.parse(event.data));
    });
  }

  silence = setTimeout(() => comeBack(0), SILENT_MS);
  hear('alive', () => {});
  hear('moment', hearer.begin);
  hear('news', hearer.news);
  hear('nodes', hearer.nodes);
  hear('office', hearer.office);
  hear('ended', () => {
    leave();
    hearer.ended();
  });
  source.addEventListener('error', () => comeBack(AGAIN_MS));
  addEventListener('pagehide', () => {
    leave();
    addEventListener('pageshow', () => comeBack(0), { once: true }); // it was kept, and somebody came back to it
  }, { signal: left.signal });
}
