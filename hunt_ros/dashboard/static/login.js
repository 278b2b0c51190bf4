// The form for a token: where a session that could command has ended, the rig can still be stopped.
'use strict';

const stop = document.getElementById('emergency');
const stopped = document.getElementById('stopped');

async function emergencyStop() {
  try {
    const reply = await fetch('command', {
      method: 'POST',
      headers: {'Content-Type': 'application/json'},
      body: JSON.stringify({word: 'emergency-stop'}),
      signal: AbortSignal.timeout(15000),
    });
    const {done, message} = await reply.json();
    stopped.textContent = `emergency stop: ${message || (done ? 'done' : 'refused')}`;
  } catch (error) {
    stopped.textContent = 'emergency stop: NO ANSWER FROM THE SERVER: USE THE HARD-WIRED STOP';
  }
}

stop.onclick = emergencyStop;
document.addEventListener('keydown', (event) => {
  if (event.key === 'Escape' && !event.repeat && !document.getElementById('last').hidden) { event.preventDefault(); emergencyStop(); }
});
