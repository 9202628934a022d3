/** Listens to a run that goes on. After the connection was lost it comes back by itself, and begins anew. */
export function listen({ begin, news, nodes, ended, lost }) {
  const source = new EventSource('/api/live');
  source.addEventListener('moment', event => begin(JSON.parse(event.data)));
  source.addEventListener('news', event => news(JSON.parse(event.data)));
  source.addEventListener('nodes', event => nodes(JSON.parse(event.data)));
  source.addEventListener('ended', () => {
    source.close();
    ended();
  });
  source.addEventListener('error', () => {
    if (source.readyState !== EventSource.CLOSED) lost();
    else setTimeout(() => listen({ begin, news, nodes, ended, lost }), 2000);
  });
  addEventListener('pagehide', () => source.close());
}
