// A worker that holds a lock while it lives, and is the one that the address names after the question mark.

navigator.locks.request(crypto.randomUUID(), () => new Promise(() => {}));
await import(location.search.slice(1));
