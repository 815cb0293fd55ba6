// Moves Meshcat's recorded animation to the time that the page around it asks for.
(() => {
  const patience = 120; // For a large recording on a slow machine, [s].
  const start = performance.now();
  let wanted = 0;
  let isReady = false;
  const animator = () => globalThis.viewer?.animator;

  function place() {
    if (!isReady) return;
    animator().pause();
    animator().seek(wanted);
    animator().display_progress(wanted);
  }

  // A script that Meshcat brings for its workers would send each message to this page again.
  globalThis.onmessage = null;
  addEventListener("message", ({ data }) => {
    if (!Number.isFinite(data)) return;
    wanted = data;
    place();
  });

  const waiting = setInterval(() => {
    if (animator()?.actions?.length) {
      clearInterval(waiting);
      isReady = true;
      place();
      parent.postMessage({ duration: animator().duration }, "*");
    } else if (performance.now() - start > 1000 * patience) {
      clearInterval(waiting);
      parent.postMessage({ missing: true }, "*");
    }
  }, 100);
})();
