// Starts the page: inflates the viewer and runs it, which its hash in the page's policy permits.

const status = document.getElementById("status");

function report(error) {
  status.textContent = `This replay cannot be shown: ${error.message || error}`;
  status.hidden = false;
  console.error(error);
}

// Returns the bytes of an embedded file, gzip in base64.
async function inflate(id) {
  if (!window.DecompressionStream) throw new Error("this browser is too old. Chrome 80, Firefox 113 or Safari 16.4 can.");
  const element = document.getElementById(id);
  const text = atob(element.textContent);
  element.remove();
  const bytes = new Uint8Array(text.length);
  for (let i = 0; i < text.length; i++) bytes[i] = text.charCodeAt(i);
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
  return new Response(stream).arrayBuffer();
}

async function boot() {
  const script = document.createElement("script");
  script.textContent = new TextDecoder().decode(await inflate("viewer"));
  document.head.append(script);
  window.replay.start(await inflate("scene"), await inflate("data"), report);
}

boot().catch(report);
