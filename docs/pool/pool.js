// The pool: the worker that computes, and the page around it.

// A worker that computes runs.
function computer() {
  const worker = new Worker(URL.createObjectURL(new Blob([WORKER], { type: "text/javascript" })));
  worker.postMessage({ load: DATA });
  return worker;
}

// A whole run at once, without the clock: {rows, start, wall_s}; see whole_run in worker.js.
function simulate(law, values, seconds, during) {
  const worker = computer();
  return new Promise((resolve) => {
    worker.onmessage = ({ data }) => {
      if (data.loaded) worker.postMessage({ whole: { law, values, seconds, during } });
      else resolve(data.whole), worker.terminate();
    };
  });
}

window.uvms_mj_pool = { simulate };
