"""Which samples count and when: queues, watermark, clocks of the channels, and the journal."""
